"""Output of results for users: JSON, text, HTML and pictures.

blocks Work in blocks: in this process, by local workers, a Dask cluster, or job arrays budget Error
of one image link by link: numbers, text, page and pictures common/ Parts of all reports: outputs,
records, templates, times and provenance comparison `xfrustum compare`: two images from files
conformance/ Conformance suite of a renderer: cases, trials, statement cost Error against time of
the ways to draw device         Rounding of the current OpenGL device: table, page and model
displays Notebook displays of the objects of `scenes` and `compare` error_report/ `xfrustum report`:
every setting of a scene drawn and judged exchange/ Plates in layouts of files, and cameras for
other renderers figure7 Figure 7 of the paper as a page heat_map Heat map of a plate, and its chosen
apertures with their reasons inspection Hogels in panes, and the values at wrong pixels notebook
Notebook display of results: pictures, and the base class parts Hogels in blocks, and a folder of
Parquet parts planning `xfrustum plan`: settings to draw with, and their errors plate/ Plates drawn
into stores, by any number of processes scene_check/ Checks and effects of a scene, and scene files
for a mesh schemas/ JSON schema of each record that a command prints survey/ Hogels judged all over
a plate, and bounds for the whole plate templates/ Templates and scripts of pages and texts text
Sentences for the codes and records of lower rooms trace `xfrustum trace`: the truth of one aperture
to a file verification/ Verification of foreign renderers: sources, verdict, baselines view Views of
eyes: scene, replayed truth and drawn hogels
"""
