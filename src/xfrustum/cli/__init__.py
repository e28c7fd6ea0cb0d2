"""The command line: from arguments to a command and its exit status.

commands/  the commands by use: scene, aperture, comparing, planning, plates, verifying,
           conformance, eye, studies
app        The group of all commands: their order by use, each loaded from its module when it is
called light      Options about light: effects, numbers of samples, light transport main       The
command line as a process: from arguments to an exit status, whatever happens on the way options
Options that commands share, the kinds of values that they take, and how commands print
"""
