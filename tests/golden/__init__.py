"""Golden corpus: outputs of version 0.2, and the command that compares a checkout with them.

    python -m tests.golden compare          everything (some minutes)
    python -m tests.golden compare truths   one part: truths, rasters, answers, wrong-renderers
    python -m tests.golden make FOLDER      a corpus of this checkout, made in the same way

`truths.npz` and `rasters.npz` are small images of all built-in scenes, hard cases and scenes of
`../shared`; `answers.json.gz` has output and files of commands; `wrong-renderers.txt` is the table
of `python -m tests.wrong_renderers`. Version 0.2 made them before its code was reduced. They are
evidence of past behavior, and no proof of correctness: `answers.EXPECTED` explains differences.
"""
