"""The diagnosis of measured frequency responses: which linear effects a model lacks, and whether a level shows."""
