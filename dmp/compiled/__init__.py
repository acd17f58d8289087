"""Kernels for what takes memory traffic rather than arithmetic; compiled when first needed, and kept compiled on disk."""
