"""The blind benchmark of `cellwatt explain`, as one object; see the package `concealed` beside this file.

python bench/concealed.py --json [--cases N] [--jobs 2] [--work DIR] [--seed-file FILE] [--only WORD …]
"""

from concealed.runner import main

if __name__ == "__main__":
    main()
