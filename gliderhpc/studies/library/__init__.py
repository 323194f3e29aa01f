"""Methods that several studies share: trends, turbulence statistics, ocean models, tracks."""
