"""The error budget: wrong pixels charged to links of the chain.

budget           Every wrong pixel charged to one link of the chain, and every rounding explained
explain          Causes of pixels where our rasterizer shows another triangle than its own cameras, traced
                 exactly
radiance_budget  The radiance error of an image, link by link: signed differences that add up
shear            The shear error alone: how far a shear about the cameras moves each point, measured and
                 in closed form
wrong_by_depth   Pixels that show a wrong surface because of the depth buffer: they are right with an
                 exact one
"""
