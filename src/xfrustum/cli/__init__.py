"""The command line: from arguments to a command and its exit status.

* comparing, pictures, plates, scenes, studies, verifying: the commands by use
* app: the group of all commands, ordered by use, each loaded from its module when it is called
* light: options about light: effects, numbers of samples, light transport
* main: the command line as a process: from arguments to an exit status, in every case
* options: options that commands share, kinds of option values, and printing of results
"""
