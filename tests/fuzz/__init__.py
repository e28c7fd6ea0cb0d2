"""A fuzzer that stays: hostile inputs of every kind that is read, each in a process of its own.

inputs      an input: some files and a command line, and the valid ones that mutation starts from
mutations   seeded damage: to bytes, to numbers and names in texts, to structure child       one
input in a forked process, with limits on time and bytes, and what no outcome may be:
            tracebacks, crashes, hangs, memory, leftovers
entries     commands that read what `verify`, `check` and `survey` read, in less time __main__
`make fuzz`: many inputs of each kind, counted by exit status; findings go to `corpus`, of which
            `--replay` tries every input again
kill        `make kill`: signals at random moments of every command

What `corpus` holds is replayed by `make test` (tests/test_fuzz_corpus.py).
"""
