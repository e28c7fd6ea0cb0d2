"""Error report: every setting of a scene drawn and judged; page, JSON and Parquet.

sweep    Options and grid of settings; measurement of every setting at every aperture, and of light
best     Rows, and the choice of the best depth buffer and near planes
figures  Figures of the page: errors and causes over near planes
report   `xfrustum report`: numbers, sentences, page and inspection, written together
"""
