"""Methods shared by several studies: trends, turbulence statistics, ocean models, tracks."""
