"""Which surface points a pencil's lines see: certified, by the bounds of the truth.

boxes       Triangles as boxes of cells on the film: what shares no cell with a point cannot hide it
distance    Distances of points from triangles and from their planes
kept        What was made last, kept for as many threads as there are, in bounded memory
sight       Surface points that the true frustum does not see, because another surface hides them
walk        Surfaces that a line may meet before its end, by the bounds of double precision, on NumPy
            and Dr.Jit
walk_jit    The search for what may hide points, compiled by Dr.Jit for all processors
walk_numpy  The search for what may hide points on NumPy, where there is no LLVM for Dr.Jit
"""
