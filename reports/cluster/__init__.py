"""Whole plates in blocks of hogels, done by one process or by the workers of a Dask cluster.

blocks       Blocks of hogels: pieces of a plate, or of samples of it, each computed by its number
claims       Claims: which process does which piece of work, where several work on one store at once
cluster      Clusters of Dask workers: one of this machine, started and stopped here, or one that exists
differences  What differs between two descriptions of work, in words
job          What a worker does with a block: the session of its process, and blocks that somebody else makes
parts        A folder of Parquet parts, one for each block, each there whole or not at all
processes    Worker processes of this machine: started, started again when they die, and ended with the
             command
rows_job     Work whose blocks of hogels become Parquet parts: everything but what a session does with a block
run          Blocks done by a cluster or in this process, those that are not finished yet, with one bar for
             all
ticket       A scene as it travels to workers: by path and content hash
worker       A worker process of this machine: the program that a command starts, once for each worker
"""
