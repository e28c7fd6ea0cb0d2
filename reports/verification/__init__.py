"""The verification of foreign renderers: sources, verdict, files.

baseline      `verify --baseline`: a verification is held to the measures that were accepted before
files         What a verification leaves behind: a page, JSON, JUnit XML, and lines for the terminal
laid_out      Other layouts in which the files of a plate may be meant, where they are wrong in the stated
              one
sources       Where a foreign renderer's hogel images come from: files, a layout of files, a program, or a
              function
verdict       The answer to `xfrustum verify`: limits, every hogel's figures, and all of them together, also
              in words
verification  `xfrustum verify`: is a renderer that nobody here wrote right, and if not, what is wrong
              with it?
workers       `verify --workers`, `--scheduler` and `--part`: blocks of hogels that any process judges as
              `verify` does
worst_hogels  Pictures of the worst hogels, kept small while all hogels pass by
"""
