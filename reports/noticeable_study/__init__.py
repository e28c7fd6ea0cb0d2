"""The study of what viewers notice of the near offset and of depth buffers.

document  The study as a document: text from a template, every number from the rows
facts     What the rows of the study of viewers say: thresholds, counts, and replays beside closed forms
figures   The figures of the study of viewers, as SVG that needs nothing else
grid      What the study of viewers asks: scenes, nears, depth buffers, pitches, distances, and what is
          replayed
rows      The answers of the study of viewers as rows, and as Parquet
rule      The rule for a near that no eye notices, and how the rows of the study keep it
run       Answer the study's questions: closed forms for all cells, and replays of those that are not yet
          on disk
study     `xfrustum study noticeable`: answered, written down, and resumed where it was stopped
"""
