"""The blind benchmark of `cellwatt explain`, as one object; see the package `concealed` beside this file.

python bench/concealed.py --markdown --work DIR [--jobs 2 | --scheduler PLACE] [--only WORD …]

Started again with the same --work, it goes on where it was stopped; --make makes the cases alone beforehand.
"""

from concealed.runner import main

if __name__ == "__main__":
    main()
