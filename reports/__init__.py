"""The verdict: sweeps over settings, tables, figures and the page that a person opens."""
