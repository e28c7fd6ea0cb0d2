"""Plates drawn into stores, by any number of processes.

layout    What a plate's store holds: its arrays and their labels, and its blocks of hogels
plate     Plates drawn block by block into a store, by this process or by others, and never twice
rows      Plates in Zarr groups as rows of pixels, for conversion from and to layouts of files
sources   Sources of a plate's hogels: drawn, drawn and judged, or traced; their measures; what decides pixels
store     A plate on disk: its Zarr group and its table of measures (`rows` makes groups of `convert`)
"""
