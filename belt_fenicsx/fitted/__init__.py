"""Finite elements whose nodes move with the joints of the zones."""
