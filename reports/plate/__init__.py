"""Plates drawn into stores, by any number of processes.

layout    What a plate's store holds: its arrays and their labels, and its blocks of hogels
measures  How each hogel of a plate differs from its truth: rows of a table, and arrays of its columns
plate     Plates drawn block by block into a store, by this process or by others, and never twice
rows      Plates in Zarr groups as rows of pixels, for conversion from and to layouts of files
sources   Sources of a plate's hogels: drawn, drawn and judged, or traced; and what decides their pixels
store     A plate on disk: draws, resumes and reads its Zarr group (`rows` makes those of `convert`)
"""
