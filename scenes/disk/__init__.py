"""Files on disk: bounded reading, atomic writing.

durable Atomic writing: files and folders are complete or absent, also after a crash input_files
Files and archives of users: regular files only, and a bound on memory
"""
