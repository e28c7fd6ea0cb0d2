"""What a foreign renderer does otherwise than asked, and whether that explains its errors.

`diagnosis.diagnose(evidence)` returns the findings. A mistake without numbers is an entry of
`faults.HYPOTHESES`, one with numbers a group of `compare.renderer_model.drawn_model`, one of lens
or pixels a field of its `Film`.

composition   How a renderer puts its two halves together: one missing, mirrored or on top, culling
depth_faults  Mistakes along lines: surfaces cut off by another reach, and a depth buffer that is
too coarse diagnosis     Diagnosis before verdict: what a renderer does otherwise than asked, from
some of its hogels encodings     The meaning of stored pixels, found by reading them in other ways
and comparing with the scene faults        The faults of a renderer: the table of mistakes without
numbers, and the words of all film_faults   How pixels may lie on their film: rolled, enlarged from
fewer, or behind a lens geometry_fit  Conventions and geometry of a renderer, from what its images
claim: enumerated, fitted, bounded hogel_faults  Mistakes of single hogels: stale, exchanged,
jittered or shifted ones registration  Conventions and geometry from pictures without triangles:
registered with the reference's own scene_faults  Mistakes of the scene: axes exchanged or negated,
and objects missing, moved, turned or resized
"""
