"""The conformance suite: hands cases to a renderer, judges what it draws, and writes a statement.

cases      The folder that a renderer is handed for a case; the archive of all cases with their
truths run        Cases handed to a renderer, judged in blocks by any process; causes named by
`verify` statement  The verdicts as a statement, a page, JUnit and a badge
"""
