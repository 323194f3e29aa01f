"""The flight model as users meet it: checked arrays in, kernels called, arrays out."""
