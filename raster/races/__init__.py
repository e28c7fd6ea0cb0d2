"""What drawing many hogels at once is measured against.

plain_loop   What drawing many hogels at once is measured against: one hogel after the other, all
             triangles twice
plate_rates  Contestants for a race over one row of a plate: many hogels at once, and loops that anybody
             would write
"""
