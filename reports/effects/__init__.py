"""What a scene calls for, and what it costs.

cost_record  The time that one effect adds to an image, as it was measured, and how
costs        What an effect costs: the same image with and without it, in turn, and the median of the
             differences
depths       What near offset, depth buffer, shear and band limiting do at each depth of a scene, in
             closed form
plan         The effects that a scene calls for: each used or left out, the fact that decided it, and its cost
table        What a scene calls for, as text and as JSON
viewer       The limits of a scene's display for a viewer, in words and beside a near offset
"""
