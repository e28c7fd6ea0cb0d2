"""How time and memory grow with triangles, pixels and apertures.

contestants  The contestants in a race against size: rasterizer and tracers, each loaded and set up by
             itself
expected     Why does each cost grow as it does? The exponent to expect of every contestant, and the reason
extent       What grows, how far, and what stays as it is meanwhile
fit          How does a cost grow? Exponents of power laws, and where one curve crosses another
page         `xfrustum bench scaling` as a page: the curves of every axis, logarithmic both ways, and
             their reasons
process      One contestant at one size in a process of its own: seconds, and the most memory it ever had
scaling      How do time and memory grow with triangles, pixels and apertures, and where does tracing
             overtake?
table        `xfrustum bench scaling` as text: tables of every axis, exponents with their reasons,
             crossovers
"""
