"""The devices that the reference computes on: LLVM through Dr.Jit, threads, bands of rows.

arithmetic      Arithmetic that NumPy and Dr.Jit name differently, so that formulas are written once for both
arithmetic_jit  Dr.Jit's arithmetic, and its arrays on the device: the processors, through LLVM
bands           Images in bands of rows, made on all processors, in bounded memory
dr_jit          The choice of Mitsuba's variant and of the LLVM under it, made once, before Dr.Jit chooses
packets         Memory that kernels may read in whole packets of lanes
strict_jit      Dr.Jit as the certificate needs it: one recorder at a time, and IEEE arithmetic
threads         The number of threads that the reference uses
"""
