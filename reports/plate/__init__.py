"""Plates drawn into stores, by any number of processes.

blocks       Blocks of a plate drawn by any process: a plan that fits into a message, and a function that
             draws one
camera       The camera of any hogel of a plate, from the attributes that its store has
chunks       Is a chunk of a plate all there? From the layout of its Zstandard frame, without decompressing
             it
description  The description of a plate: everything that decides its pixels, and must agree to go on with a
             store
engine       Plates on the engine of `reports.cluster`: blocks drawn by worker processes, by a cluster, or in
             parts
layout       What a plate's store holds: its arrays and their labels, and the blocks of hogels that are their
             shards
measures     How each hogel of a plate differs from its truth: rows of a table, and the arrays made of its
             columns
plate        A plate as a stream: any of its apertures drawn into a store, a few at a time, and never twice
shards       Files of a block's hogels: Zarr shards, whose index tells which hogels are there, and single
             chunks
sources      Sources of a plate's hogels: many at once, one after the other with finer sampling, or truths
store        A plate on disk: a Zarr group whose shards are blocks of hogels, each file there whole or not at
             all
stored       A plate on disk for those who read it: what it says of itself, and which of its hogels are
             finished
"""
