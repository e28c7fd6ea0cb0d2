"""The commands, a module for each use.

checks   `budget`, `selfcheck` and `bench`: causes of an error, a check of the truth, and speeds
cost     `cost`: error against time of many settings
explain  `explain`: what a scene calls for, before anything is simulated
plan     `plan`: settings that meet requirements
plate    `plate`: whole plates, drawn into a store
scene    `new` and `check`: a scene file that fits a mesh, and whether a scene makes sense
study    `study`: measurements over many scenes and settings
verify   `verify`: foreign renderers are diagnosed and judged
"""
