"""Error against time.

trade_off         Error against time: which configurations are worth it, and which is the cheapest within
                  a tolerance
trade_off_figure  Error against time as a figure, the Pareto front drawn through the options that are on it
trade_off_record  Error against time as `cost --json` prints it: the options and what tolerances cost
"""
