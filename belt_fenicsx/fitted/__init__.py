"""Finite elements whose nodes move with the borders of the zones."""
