"""The command line: from arguments to a command and its exit status.

commands/    the commands, a module for each use
app          The group of all commands, and those of one image
completion   Completion of commands, options and scenes by the shell (bash, zsh, fish), as click offers it
files        Errors of file systems in words: impossible names, and places without room
help         The text of `--help`: commands by their use, and an example that ends the help of each command
light        Options of the command line about light: effects, numbers of samples, light transport
main         The command line as a process: from arguments to an exit status, whatever happens on the way
numbers      Numbers on the command line, whose errors name the option that they were given to
options      Options that commands share: apertures, near planes, settings of the double frustum
tev          The option `--tev`: what an inspection page holds, sent to a running viewer
where        Options that say where blocks are done: by processes of this machine, a cluster, or in parts
"""
