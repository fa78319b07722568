"""The terms that the data support: the regression problem of one side, its noise, and the search.

sides, problem, rows, noise, metering          torques or power as a regression, the fitted rows, their noise
search, coordinate_search, solution            the terms that are tried, and what was found
leave_out, acceptance, thresholds, retuning    the test on data left out, and what it decides
nuisance, coupling, holding, swinging_links    nominal numbers, coupled motors, friction at rest, links that swing
"""
