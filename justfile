python := ".venv/bin/python"

# List the recipes.
default:
    @just --list

# Everything a change must pass: all tests but the slow ones, lint, types, import rules.
test *arguments:
    {{ python }} -m pytest -n auto {{ arguments }}

# Only what takes longer than ten seconds.
slow *arguments:
    {{ python }} -m pytest -m slow {{ arguments }}

# Property tests with other draws in each round; `just test` draws the same in each run.
explore rounds="10":
    for round in $(seq {{ rounds }}); do {{ python }} -m pytest -n auto -q --hypothesis-profile explore -m hypothesis || exit 1; done

# Ruff, mypy --strict, import-linter, clean pins.
lint:
    {{ python }} -m pytest -n auto tests/test_quality.py

# The front end of the page, its own tests first; needs Node.js.
front:
    cd daemon/cellwatt/outlets/page/front && npm ci && npm test && npm run build

# The pages of docs/ as a site, every link checked.
docs:
    {{ python }} -m mkdocs build --strict

# The figures of docs/performance.md.
bench *arguments:
    {{ python }} bench/daemon.py --json {{ arguments }}

# Which lines and branches of the three packages the tests run.
coverage *arguments:
    {{ python }} -m pytest -n auto --cov --cov-report=term:skip-covered {{ arguments }}

# Sdist, wheel and Debian package in dist/; --snapshot for a commit that is no release.
build *arguments:
    {{ python }} -m release.build {{ arguments }}

# The wheel, installed with nothing but its pins, run.
try-wheel:
    {{ python }} -m release.try_wheel

# The Debian package in a clean root of debootstrap, as root.
try-deb package root:
    {{ python }} -m release.try_deb {{ package }} {{ root }}

# The container image on such a root, as root; needs buildah.
try-container root:
    {{ python }} -m release.try_container {{ root }}
