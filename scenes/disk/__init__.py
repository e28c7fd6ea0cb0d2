"""Files on the disk: read within bounds, written whole or not at all.

archives     Zip archives and NumPy's .npz from outside durable      Files and folders that are
whole or absent, whatever ends the process or fills the disk input_files  Files from outside:
regular files only, and a bound on the memory that reading one may take
"""
