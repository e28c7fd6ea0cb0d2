"""Plates drawn into stores, by any number of processes.

plate  Sources of hogels: drawn, drawn and judged, or traced; and plates drawn block by block, never
twice store  A plate on disk: its arrays and blocks, its Zarr group, and its table of measures
"""
