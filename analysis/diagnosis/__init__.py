"""What a simulation gets wrong, why, and what fixing it gains; one folder for each part of the method.

From the bottom: `nominal` (the linear model), `records` (what was measured), `noise`, `candidates` (the effects of the
library), `fitting`, `search`, `verdict`, `spread` (causes that show only in the spread of the residual), `experiment`
(what would tell apart what is tied). Beside them `evidence` and `answer` (sentence, page, files).

`pipeline` puts them in order, `api` is the door for scripts, `investigation` goes round with a bench, `dominant`
searches for one cause where a model misses by many noises, and `result` is what a diagnosis says.
"""
