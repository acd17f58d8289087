"""Kernels that are compiled when they are first needed, and kept compiled on disk: where memory, not arithmetic, takes the time."""
