"""The error report: every setting of a scene drawn, judged and timed; page, JSON and Parquet.

causes           Causes of wrong surfaces over near: a stacked figure for each depth buffer, and which one
                 dominates
figures          The curves of a report, as plotly figures: error against near, prediction drawn in, time
                 per stage
geometries       Camera geometries of a report side by side: curves over near, and what the shear alone
                 does to points
images           Pictures for people: encoded, small, with scales that stay the same over a whole report
page             The page: one HTML file with its pictures, its plots and plotly.js inside
report           `xfrustum report`: writes index.html, report.json and measurements.parquet, all or none
report_records   Dataclasses of the objects in report.json and of the rows in measurements.parquet
shading          What a report says about light beside its rows: effects and their time, the eye vector,
                 what is missed
shading_measure  Measuring light for a report: effects and their time, the eye vector, what is missed
shading_page     What the page of a report shows of a shaded scene, and nothing for others
sweep            The main job: trace the truth once per aperture, rasterize every setting, compare each
tables           The content of report.json, and measurements.parquet
"""
