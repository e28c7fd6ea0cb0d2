"""Error report: every setting of a scene drawn and judged; page, JSON and Parquet.

sweep    Options and grid of settings; measurement of every setting at every aperture, and of light
best     Rows, the choice of the best depth buffer and near planes, and figures of the page
report   `xfrustum report`: numbers, sentences, page and inspection, written together
"""
