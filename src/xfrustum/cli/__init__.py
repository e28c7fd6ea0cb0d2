"""The command line: arguments in, exit status out, and nothing else.

commands/    the commands, a module for each use
failure      An unexpected error: one line, exit status 70, and a traceback that can be sent in
files        What file systems refuse, whatever command asked for it: impossible names, and places
             without room
light        Options of the command line about light: effects, numbers of samples, light transport
main         The command line: arguments in, exit status out, and nothing else
numbers      Numbers on the command line, whose errors name the option that they were given to
options      How the command line spells apertures, near planes and the settings of the double frustum
streams      Standard output and standard error: what is written there, also where nobody can read it
termination  Ctrl-C and SIGTERM end a command cleanly, whatever it is doing when they come
"""
