"""Wrong renderers and a right one, written from CONVENTIONS.md, without code of the package.

| module | content |
| --- | --- |
| `worlds` | the scenes: triangles made here, written as TOML and OBJ for `xfrustum verify` |
| `ray_caster` | the right renderer: every line against every triangle, in plain NumPy |
| `toys` | the wrong renderers, each a few lines on top of the right one |
| `new_toys` | more of them, written later, and pairs of two mistakes |
| `differences` | how wrong a picture really is, by brute force |
| `outcomes` | result of `xfrustum verify` for each, and the table of all |

`python -m tests.wrong_renderers` prints the table, and the number of named causes; `--group`
selects a part of it.
"""
