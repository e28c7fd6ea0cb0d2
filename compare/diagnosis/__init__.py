"""What a foreign renderer does otherwise than asked, and whether that explains its errors.

views/        Mistakes of renderers whose hogels are put together from views
claims        The claims of images: this pixel, of this file, shows this triangle
composition   The way in which the two halves are put together, found by trying every one
containment   The distance of a pixel's center from the projection of the triangle that it claims to show
diagnosis     Diagnosis before verdict: what a renderer does otherwise than asked, from some of its hogels
encodings     The meaning of stored pixels, found by reading them in other ways and comparing with the scene
explained     The test of a diagnosis: the share of the wrong pixels that it explains, and whether each
              fault pays
faults        The faults of a renderer, in words with figures
feasible      The interval of each parameter of a guess: all values under which no claim fails
findings      The reading of a renderer's pixels and the way it draws, tested together
geometry_fit  Conventions and geometry of a renderer, from what its images claim: searched, fitted, bounded
registration  Conventions and geometry from pictures without numbers of triangles: registered with the
              reference's own
starts        The conventions and the numbers from which fits of geometry start: those under which claims
              fail least
stored_truth  Stored pixels beside what the truth would have stored, and the damage that explains the
              difference
"""
