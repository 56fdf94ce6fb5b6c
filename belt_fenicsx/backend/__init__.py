"""What PETSc, MPI, DOLFINx, the cache of compiled forms and signals need; it knows no belt."""
