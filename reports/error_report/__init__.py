"""The error report: every setting of a scene drawn and judged; page, JSON and Parquet.

best    What a report sweeps, one row of it, and which depth buffer and nears are best, in a
sentence images  Pictures for people: encoded, small, with scales that stay the same over a whole
report page    The page: one HTML file with its pictures, its figures and plotly.js inside report
`xfrustum report`: draws and judges every setting at every aperture, and writes what it found
"""
