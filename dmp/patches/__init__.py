"""Training where the layers of the whole mesh do not fit into memory: gradients are found patch by patch."""
