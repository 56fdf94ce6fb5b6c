"""Steady motion of a shear-deformable belt in frictional contact with a rotating pulley."""
