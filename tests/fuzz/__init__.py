"""A fuzzer: damaged inputs of every kind, each read in a separate process.

inputs     Valid files and command lines, from which mutation starts
mutations  Seeded damage to bytes, to numbers and names in text, and to structure
child      One input in a forked process with limits on time and size, and forbidden outcomes
entries    Commands that read the inputs of `verify`, `check` and `survey` without slow work
__main__   `make fuzz`: counts by exit status; findings go to `corpus`, which `--replay` tries again
kill       `make kill`: signals at random moments of commands

`make test-all` replays `corpus` (tests/test_fuzz_corpus.py).
"""
