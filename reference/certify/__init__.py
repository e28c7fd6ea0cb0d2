"""The first surface along each line: proven, decided exactly, or named a tie.

arbitrary_lines  First surfaces along any lines through one point, not only those of a film; all decided
                 exactly
certify          The decision: pixels that `narrow` settles are proven; contested ones proven, decided
                 in integers, or ties
exact            Decisions in integers: whether and where a line meets a triangle
footprints       The part of the film on which each triangle can show: conservative boxes of pixels
narrow           The narrow phase: each pixel against each triangle whose box holds it, in doubles,
                 roundings bounded
narrow_jit       The narrow phase compiled by Dr.Jit for all processors: one lane for each row of a triangle
narrow_numpy     The narrow phase on NumPy, where there is no LLVM for Dr.Jit
processors       The choice between Dr.Jit on LLVM and NumPy, and of the number of threads that run Dr.Jit's
                 kernels
rows             The rows of pixels that triangles' boxes on the film reach into
runner_up        The distance between the first surface of each line and the next one on the same side
runner_up_jit    Second surfaces compiled by Dr.Jit: one more walk over the lanes of the narrow phase
sides            Triangles sorted into those behind the height of a pencil's center and those before it
spans            The columns of a row between which a triangle can be met, by its three edge functions
"""
