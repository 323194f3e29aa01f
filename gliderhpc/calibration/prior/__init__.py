"""Maximum-likelihood disturbance prior of filter and smoother, from the filter's innovations."""
