"""Which surface points a pencil's lines see: certified, by the bounds of the truth.

boxes       Triangles as boxes of cells on the film: what shares no cell with a point cannot hide it
clear       Clear triangles: nothing hides them well inside their outlines, so that their points need not be
            searched
clear_jit   The search for clear triangles, compiled by Dr.Jit; `clear` says what they are and why
coarse      Coarse cells of the film, and the triangles that reach into each: found once for a pencil
distance    Distances of points from triangles and from their planes
few         The search for what may hide few points, on NumPy, among what reaches into their coarse cells
kept        What was made last, kept for as many threads as there are, in bounded memory
rows_jit    Rows of the boxes of triangles as Dr.Jit arrays: one lane for each walks what lies in its cells
sight       Surface points that the true frustum does not see, because another surface hides them
walk        Surfaces that a line may meet before its end, by the bounds of double precision, on NumPy
            and Dr.Jit
walk_jit    The search for what may hide points, compiled by Dr.Jit for all processors
walk_numpy  The search for what may hide points on NumPy, where there is no LLVM for Dr.Jit
"""
