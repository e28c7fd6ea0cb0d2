"""The command line: from arguments to a command and its exit status.

commands/    the commands, a module for each use
completion   Completion of commands, options and scenes by the shell (bash, zsh, fish), as click offers it
failure      An unexpected error: one line, exit status 70, and a traceback that can be sent in
files        Errors of file systems in words: impossible names, and places without room
help         The text of `--help`: commands by their use, and an example that ends the help of each command
light        Options of the command line about light: effects, numbers of samples, light transport
main         The command line: from arguments to a command and its exit status
numbers      Numbers on the command line, whose errors name the option that they were given to
options      Options that commands share: apertures, near planes, settings of the double frustum
process      How the process of a command keeps memory, and how its threads share Python
streams      Standard output and standard error, also where they are closed, full or broken
tev          The option `--tev`: what an inspection page holds, sent to a running viewer
termination  Ctrl-C and SIGTERM end a command cleanly, whatever it is doing when they come
where        Options that say where blocks are done: by processes of this machine, a cluster, or in parts
"""
