"""The experiment that would tell apart what is tied, played on paper first."""
