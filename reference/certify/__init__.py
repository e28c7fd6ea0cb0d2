"""Who is first along each line: proven, decided exactly, or named a tie.

arbitrary_lines  First surfaces along any lines through one point, not only those of a film; all decided
                 exactly
certify          Who is first along each line? Proven in double precision, decided in rationals, or a tie
exact            Rational decisions: does a line meet a triangle, where, and who comes first?
footprints       Where on the film can each triangle show? Conservative boxes of pixels, once for an image
narrow           Pixel against triangle in double precision, with a bound on every rounding error
narrow_jit       The narrow phase compiled by Dr.Jit for all processors: one lane for each row of a triangle
narrow_numpy     The narrow phase on NumPy, where there is no LLVM for Dr.Jit
processors       What the double-precision arithmetic runs on: Dr.Jit on LLVM, or NumPy where there is none
rows             Which rows of pixels do triangles' boxes on the film reach into?
runner_up        How far behind the first surface of each line is the next one that the same camera sees?
runner_up_jit    Second surfaces compiled by Dr.Jit: one more walk over the lanes of the narrow phase
sides            What pencils share whose centers have one height: which triangles lie behind it, and
                 which before
spans            Where along a row of pixels does a triangle begin and end? Its three edge functions say
"""
