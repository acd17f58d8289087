"""Closing one hole: triangulate its rim, refine to the density around it, make it fair (Liepa 2003)."""
