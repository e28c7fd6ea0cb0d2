"""The error budget: wrong pixels charged to links of the chain.

budget           Every wrong pixel charged to one link of the chain, and every rounding explained
recorded         Frames that were recorded on some machine, explained by the model of their device
radiance_budget  The radiance error of an image, link by link: signed differences that add up
"""
