"""The verification of foreign renderers: sources, verdict, baselines.

baseline      `verify --baseline`: a verification is held to the measures that were accepted before
sources       Where a foreign renderer's hogel images come from: files, a layout of files, a program, or a
              function
verdict       The answer to `xfrustum verify`: limits, figures and pictures of hogels, words, and files
verification  `xfrustum verify`: is a renderer that nobody here wrote right, and if not, what is wrong
              with it?
workers       `verify --workers`, `--scheduler` and `--part`: blocks of hogels that any process judges as
              `verify` does
"""
