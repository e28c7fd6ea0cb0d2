"""What a foreign renderer does otherwise than asked, and whether that explains its errors.

`diagnosis.diagnose(evidence)` returns the findings. A mistake without numbers is an entry of
`hypotheses.HYPOTHESES`, one with numbers a group of `compare.renderer_model.parameters`.

claims        The claims of images: this pixel, of this file, shows this triangle; and by how much claims fail
diagnosis     Diagnosis before verdict: what a renderer does otherwise than asked, from some of its hogels
encodings     The meaning of stored pixels, found by reading them in other ways and comparing with the scene
evidence      Images of a renderer as evidence: how much of what is wrong a guess explains, and what it spoils
faults        The faults of a renderer, in words with figures
geometry_fit  Conventions and geometry of a renderer, from what its images claim: enumerated, fitted, bounded
hypotheses    Mistakes without numbers: one entry for each, drawn and compared with the images
registration  Conventions and geometry from pictures without triangles: registered with the reference's own
"""
