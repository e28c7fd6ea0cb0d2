"""The commands, a module for each use.

camera   The command that writes the cameras of a plate for other renderers
checks   Commands that examine causes of errors (`budget`), the truth (`selfcheck`) and speed (`bench`)
convert  The command that writes a plate in another layout of files
cost     The command about time: what accuracy costs
explain  The command `explain`: the effects that a scene calls for, said before anything is simulated
figure7  The command that draws C alone, C* alone and both, as in the paper's figure 7
plan     The command that plans the settings that keep what is required
plate    The command that draws whole plates
scene    Commands about scene files: `new` writes one that fits a mesh, `check` looks for mistakes in one
study    Commands that study many scenes and settings instead of one
survey   The command that judges hogels all over a plate
verify   The command that judges renderers of other people
view     The command that shows what eyes before the plate see
"""
