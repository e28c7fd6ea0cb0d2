"""Files on the disk: read within bounds, written whole or not at all.

durable      Files and folders that are whole or absent, whatever ends the process or fills the disk
input_files  Files and archives from outside: regular files only, and a bound on memory
"""
