"""Output of results for users: JSON, text, HTML and pictures.

* blocks: work in this process, by local workers, on a Dask cluster, or in job arrays
* budget: error of one image link by link, as numbers, text, page and pictures
* common: outputs, records, templates, pictures and times of all reports
* conformance, conformance_cases: conformance suite of a renderer, from cases to a statement
* cost: error against time of the ways to draw
* device: rounding of the current OpenGL device, as table, page and model
* displays: notebook displays of the objects of `scenes` and `compare`
* error_report: `xfrustum report`, every setting of a scene drawn and judged
* exchange: plates in layouts of files, and cameras for other renderers
* image_files: `xfrustum trace` and `xfrustum compare`, images of an aperture as files
* inspection: hogels in panes, and the values at wrong pixels
* notebook: notebook display of results, and its base class
* parts: hogels in blocks, and a folder of Parquet parts
* planning: `xfrustum plan`, settings that meet a requirement and their errors
* plate: plates drawn into stores, by any number of processes
* plotting: style of figures, heat maps of plates, and chosen apertures with their reasons
* scene_check: checks and effects of a scene, and scene files for a mesh
* schemas: JSON schema of each record that a command prints
* survey, survey_rows: hogels judged all over a plate, and bounds for the whole plate
* templates: templates and scripts of pages and texts
* text: sentences for the codes and records of lower rooms
* verification: verification of foreign renderers, from sources to verdict and baselines
* view: views of eyes: scene, replayed truth and drawn hogels
"""
