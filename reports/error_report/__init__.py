"""Error report: every setting of a scene drawn and judged; page, JSON and Parquet.

request  Settings, apertures and options, and the grid of settings
sweep    Measurement of every setting at every aperture
light    Effects, the bent eye vector, and light that a raster misses
best     Rows, and the choice of the best depth buffer and near planes
words    Sentences of the recommendation and of dominant causes
images   Pictures of truths, frames and errors, on scales that are the same in a whole report
page     One HTML file with its pictures, its figures and plotly.js inside
report   `xfrustum report`: page, numbers and inspection, written together
"""
