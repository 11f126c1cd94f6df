"""What a simulation gets wrong: residuals, screening, fitting, verdict, gain, next experiment."""
