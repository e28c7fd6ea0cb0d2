"""What the smaller commands make: budget, plan, compare, trace, figure 7.

budget_page         The folder of `xfrustum budget --out`: a page with a legend, budget.json, and the
                    pictures
budgeting           `xfrustum budget`: the error of one image link by link, in numbers
comparison          `xfrustum compare`: two images from files, and what a person wants to see of the outcome
figure7             The paper's figure 7: C, two perspectives of C* as seen and as overlaid, and both cameras,
                    as one page
planning            `xfrustum plan`: which settings to draw with, what they keep, and the command that
                    draws so
radiance_budgeting  `xfrustum budget` in radiance: the table, and a picture of what each link changes
tracing             Truth of one aperture to a file, in the memory of a band, whatever the image's size
transported         Truth of one aperture with light transport to a file: its color is a mean with a
                    variance
"""
