"""Error budget: wrong pixels charged to links of the chain.

budget           Wrong pixels charged to one link of the chain each, and every rounding explained
radiance_budget  Radiance error of an image, link by link: signed differences that add up
"""
