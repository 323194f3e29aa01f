"""``twin recoverability``: detectable yaw impulses, and the error of the unobserved part of the motion."""
