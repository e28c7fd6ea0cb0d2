"""The commands, a module for each use.

checks   Commands that examine: causes of an error, whether the truth is right, and how fast everything is
cost     The command about time: what accuracy costs
explain  `explain`: what a scene calls for, before anything is simulated
plan     The command that plans: which settings keep what is required
plate    The command that draws whole plates
scene    Commands about scene files themselves: one that fits a mesh, and whether a scene makes sense
study    Commands that study: answers over many scenes and settings, not about one
verify   The command that judges foreign renderers
"""
