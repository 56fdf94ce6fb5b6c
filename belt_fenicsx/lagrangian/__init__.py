"""The source's finite element method: a fixed mesh, and multipliers that an outer loop updates."""
