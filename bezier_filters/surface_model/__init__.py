"""The statistical model of noise and surface variation, and the specification of the fit chosen by it."""
