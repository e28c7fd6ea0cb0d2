"""What a foreign renderer does otherwise than asked, and whether that explains its errors.

claims        What images claim: this pixel, of this file, shows this triangle
composition   Which of the two halves wins where: found by comparing with every way to put them together
containment   Does a pixel's center lie inside the projection of the triangle that it claims to show?
diagnosis     Diagnosis before verdict: what a renderer does otherwise than asked, from some of its hogels
encodings     What do the pixels of a picture mean? Found by reading them in other ways, and comparing
              with the scene
explained     A diagnosis is put to the test: how much of what is wrong does it explain, and does each
              fault pay?
faults        What is wrong with a renderer, in words with figures
feasible      The interval of each parameter of a guess: all values under which no claim fails
findings      How a renderer's pixels are to be read, and how it draws: both are put to the test together
geometry_fit  Conventions and geometry of a renderer, from what its images claim: searched, fitted, bounded
registration  Conventions and geometry from pictures without numbers of triangles: registered with the
              reference's own
stored_truth  Stored pixels beside what the truth would have stored: what kind of damage explains the
              difference?
"""
