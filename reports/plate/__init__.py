"""Plates drawn into stores, by any number of processes.

plate    Plates drawn block by block into a store, by this process or by others, and never twice
sources  Sources of a plate's hogels: drawn, drawn and judged, or traced; their measures; what decides pixels
store    A plate on disk: its arrays and blocks, its Zarr group, and its table of measures
"""
