"""The error report: every setting of a scene drawn and judged; page, JSON and Parquet.

best         The recommendation: which depth buffer and near planes are best, and the sentence that says so
causes       Causes of wrong surfaces over near: a stacked figure for each depth buffer, and which one
             dominates
figures      The curves of a report, as plotly figures: error against near, prediction drawn in
geometries   Camera geometries of a report side by side: curves over near, and what the shear alone
             does to points
images       Pictures for people: encoded, small, with scales that stay the same over a whole report
light        What a report says about light beside its rows: effects, the eye vector, and what a rasterizer
             misses
measurement  What is measured of one setting at one aperture, and the pictures that belong to it
page         The page: one HTML file with its pictures, its plots and plotly.js inside
record       What a report says in words, report.json, and measurements.parquet
report       `xfrustum report`: writes index.html, report.json and measurements.parquet, all or none
sweep        The main job: trace the truth once per aperture, rasterize every setting, compare each
"""
