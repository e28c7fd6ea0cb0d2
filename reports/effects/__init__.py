"""What a scene calls for, and what it costs.

costs  What an effect costs: the same image with and without it, in turn, and the median of the differences
plan   The effects that a scene calls for: each used or left out, the fact that decided it, and its cost
table  What a scene calls for, as text and as JSON
"""
