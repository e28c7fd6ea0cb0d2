"""Conformance suite: a renderer draws cases, its images are judged, and a statement is written.

cases      Folders of cases that renderers get; archive of all cases with their truths
run        A renderer run through cases, and the causes that `verify` names
statement  Verdicts as a statement, a page, JUnit and a badge
"""
