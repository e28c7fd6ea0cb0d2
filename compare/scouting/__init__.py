"""Which apertures of a plate decide the error: a look through many, before any is measured.

automatic  The apertures that `auto` takes: the middle one, and the worst ones that a scout of the plate has
           found
sample     Random samples of hogels, and what they bound: the share of a plate's hogels with a property
scout      Coarse films of certified lines through apertures all over a plate, more where the error is largest
strata     Stratified samples that grow and keep what they have, and bounds that hold wherever one stops
"""
