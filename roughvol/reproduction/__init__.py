"""The reproduction of one paper, and numbers of the literature: claims, figures, formulas, and the report on them.

M. Paggi, Q.-C. He, Evolution of the free volume between rough surfaces in contact, Wear 336-337 (2015) 86-95. The room
knows all others, and only the command line knows it.

==============  =========================================================================
`claims`        every claim of the paper, a function of datasets, by topic
`figures`       Figs. 1 to 12, and theories beside computed curves
`formulas`      formulas of the paper and of the literature
`closed_forms`  indenters and loaded rectangles, as references
`literature`    numbers of the literature, judged as claims are
`claim_run`     a stored run as claims see it
`needs`         configuration that a claim or a number needs, and reasons to refuse a run
`judgement`     every claim answered from the runs of a report, departures from expected ones
`sections`      sections of the claims and of the literature on a page
==============  =========================================================================
"""

__all__: list[str] = []
