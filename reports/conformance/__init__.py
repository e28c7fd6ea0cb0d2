"""Conformance suite: a renderer draws cases, its images are judged, a statement is written.

cases  Input folders of cases for renderers; archive of all cases with truths
run    Runs of a renderer on cases, and verdicts as a statement, a page, JUnit and a badge
"""
