"""Design of a controller from identified models and recorded noise, never from what a bench is made of."""
