"""Plates drawn into stores, by any number of processes.

chunks  Is a chunk of a plate all there? From the layout of its Zstandard frame, without decompressing it
plate   A plate as a stream: any of its apertures drawn into a store, a few at a time, and never twice
store   A plate on disk: a Zarr group with one chunk for each hogel, which is there whole or not at all
"""
