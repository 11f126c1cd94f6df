"""The experiment that would tell apart what is tied, played on paper first, and what an instrument says of it."""
