"""What a simulation gets wrong, why, and what fixing it gains; one folder for each part of the method.

From the bottom: `nominal` (the linear model), `records` (what was measured), `noise`, `candidates` (the effects of the
library), `fitting`, `search`, `verdict`, `variance` (causes that show only in the variance of the residual),
`experiment` (which experiment distinguishes tied causes). Beside them `evidence` and `answer` (sentence, page, files).

`pipeline` puts them in order, `api` is the interface for scripts, `investigation` alternates experiment and diagnosis
on a bench, `dominant` searches for one cause where the error of a model is many times the noise, and `result` is what a
diagnosis returns.
"""
