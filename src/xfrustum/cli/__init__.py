"""The command line: arguments in, exit status out, and nothing else.

commands/    the commands, a module for each use
failure      An unexpected error: one line, exit status 70, and a traceback that can be sent in
files        Errors of the file system in words: impossible names, and places without room
light        Options about light, which several commands share: effects, samples, light transport
main         `report`, `trace`, `raster`, `compare` and `scenes`, and the exit status of every command
numbers      Types of numbers on the command line; their errors name the option
options      Options that several commands share: apertures, near planes, settings of the double
             frustum
streams      Standard output and standard error, also where they are closed or full
termination  Ctrl-C and SIGTERM end a command cleanly, whatever it is doing when they come
"""
