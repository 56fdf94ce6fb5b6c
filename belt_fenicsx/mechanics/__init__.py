"""The theory in UFL, energy first."""
