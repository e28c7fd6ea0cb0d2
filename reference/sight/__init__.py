"""Which surface points a pencil's lines see: certified, by the bounds of the truth.

boxes        Triangles as boxes of cells on the film, and the points that are asked about, sorted by cell
distance     Distances of points from triangles
sight        Surface points that the true frustum does not see, because another surface hides them
walk         The triangles that may lie before points, by the bounds of double precision: one text for all
             arithmetics
walk_jit     The search for what may hide points, compiled by Dr.Jit for all processors
walk_numpy   The search for what may hide points on NumPy, where there is no LLVM for Dr.Jit
"""
