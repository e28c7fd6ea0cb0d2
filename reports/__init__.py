"""The verdict: sweeps over settings, tables, figures and the page that a person opens.

blocks            Work in blocks: in this process, by others of this machine, by a Dask cluster, or
in parts budget            The error of one image link by link, as numbers, text, a page and
pictures common/           What all reports share: outputs, progress, times, pages, numbers in words
comparison        Two images from files compared conformance/      The conformance suite asked of a
renderer: cases, trials, and the statement to be cited cost              What accuracy costs in time
device            The OpenGL device at hand: how it rounds, as a table, a page and a model explain
What a scene calls for, what bounds its errors by depth, and what a viewer sees exchange/
The exchange with other programs: plates in layouts of files, and cameras for other
                  renderers
error_report/     The error report: every setting of a scene drawn, judged and timed; page, JSON and
                  Parquet
figure7           The paper's figure 7 as a page inspection        Inspection pages: every channel
of truth and image at every pixel, and where they differ parts             Hogels in blocks, and a
folder of Parquet parts: one for each block, each whole or not there planning          Which
settings to draw with, what they keep, what a viewer notices, and the command plate/
Plates drawn into stores, by any number of processes recommend         What depth buffer, pixels and
eyes each allow for a plate, in one answer scene_check/      Whether a scene makes sense, and scene
files that fit a mesh scout             What people see of the scout of a plate: chosen apertures
with their reasons, and a map survey/           Surveys: hogels judged all over a plate, what that
says of all, and where it is worst templates/        Pages, texts and scripts that the others fill
in trace             The truth of one aperture to a file, in the memory of a band verification/
The verification of foreign renderers: sources, verdict, baselines view              What eyes see
of a scene, of its replayed truth and of hogels, as a page and as files
"""
