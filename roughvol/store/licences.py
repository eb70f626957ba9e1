"""Licences of roughvol and of the installed packages that it needs, also of libraries that their wheels bundle.

The licence of a package is that of its metadata. Parts are shared libraries beside the package, as wheels for Linux and
macOS hold them, and the components that its licence files list. The licence of a part is that of the licence files, or
else the row of `PARTS`.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatch
from importlib import metadata

from roughvol.errors import DatasetError
from roughvol.tables import table

UNKNOWN = "unknown"
FREE, LIMITED, STRONG = "permissive", "limited copyleft", "copyleft"
RANK = (FREE, LIMITED, UNKNOWN, STRONG)
"""What a licence asks of a whole program that holds the package, from the least on."""
PARTS = table(__file__)
"""Licences of libraries whose wheel gives them none, with the starts of their names."""
_COPYLEFT = re.compile(r"\bA?GPL|(?<!Lesser )General Public License", re.IGNORECASE)
_LIMITED = re.compile(r"\bLGPL|Lesser General Public|\bMPL|Mozilla|\bEPL|\bCDDL|\bEUPL", re.IGNORECASE)
_FREE = re.compile(
    r"\b(MIT|0?BSD|Apache|ISC|PSF|Python Software Foundation|Zlib|CC0|HPND|Unlicense|Public Domain|Qhull|FTL|OFL|BSL"
    r"|curl|bzip2|Bitstream|BaKoMa|libpng|libtiff|IJG)",
    re.IGNORECASE,
)
_INNER = re.compile(r"\(([^()]* (?:AND|OR) [^()]*)\)")
_STANZA = re.compile(r"^Name: *(.+)\n(?:Files: *(.*)\n)?(?:(?!Name:|License:).*\n)*?License:\s*(.*)", re.MULTILINE)
_LIBRARY = re.compile(r"(?:^|/)[\w.-]+(?:\.libs|\.dylibs)/lib([^/]+?)(?:-[0-9a-f]{7,})*(?:\.\d+)*\.(?:so|dylib)[\d.]*$")
_REQUIRED = re.compile(r"([\w.-]+)\s*(?:\[([^\]]*)\])?")
_EXTRA = re.compile(r"""extra\s*==\s*["']([^"']+)["']""")


@dataclass(frozen=True)
class Licence:
    """An installed package, and the licences of its files.

    Attributes
    ----------
    name, version : str
        Name and version of the package.
    licence : str
        SPDX expression or words of the metadata; "unknown" without them.
    needed_by : tuple of str
        "roughvol", or the installed extras of roughvol that need the package, as "measured".
    parts : mapping of str to str
        Bundled libraries and components, with their licences.
    terms : str
        "permissive", "limited copyleft", "unknown" or "copyleft": the strictest of the package and its parts.
    deciding : tuple of str
        The licences, of the package or of its parts, that have these terms.

    See Also
    --------
    roughvol.licences : Returns the licences of roughvol and of the packages that it needs.

    Examples
    --------
    >>> from roughvol.store.licences import Licence
    >>> wheel = Licence("transform", "1.0", "BSD-3-Clause", ("roughvol",), {"libfftw3": "GPL-2.0-or-later"})
    >>> wheel.terms, wheel.deciding
    ('copyleft', ('GPL-2.0-or-later',))
    """

    name: str
    version: str
    licence: str
    needed_by: tuple[str, ...]
    parts: Mapping[str, str]

    @property
    def terms(self) -> str:
        """The strictest terms of the package and its parts."""
        return _strictest(map(terms, self._all()))

    @property
    def deciding(self) -> tuple[str, ...]:
        """The licences that have these terms."""
        return tuple(dict.fromkeys(licence for licence in self._all() if terms(licence) == self.terms))

    def _all(self) -> list[str]:
        return [self.licence, *self.parts.values()]


def licences() -> list[Licence]:
    """Return the licences of roughvol and of every installed package that it needs: `roughvol licences`.

    Returns
    -------
    list of Licence
        roughvol, then the packages of every installation, then those of the installed extras.

    Raises
    ------
    DatasetError
        If roughvol is imported from a folder without being installed.

    See Also
    --------
    roughvol.check : Returns the cost of a study.

    Examples
    --------
    >>> import roughvol
    >>> first = roughvol.licences()[0]
    >>> first.name, first.licence, first.terms
    ('roughvol', 'MIT', 'permissive')
    """
    if not _found("roughvol"):
        raise DatasetError("roughvol is imported from a folder, and not installed; allowed: pip install -e . there")
    always = _reached("roughvol", "")
    extras = {
        extra: found
        for extra in metadata.metadata("roughvol").get_all("Provides-Extra") or ()
        if all(map(_found, _direct("roughvol", extra))) and (found := _reached("roughvol", extra))
    }
    rows = []
    for name in dict.fromkeys([*always, *(name for names in extras.values() for name in names)]):
        needed_by = ["roughvol"] if name in always else [extra for extra, names in extras.items() if name in names]
        rows.append(_row(metadata.distribution(name), needed_by))
    return sorted(rows, key=lambda row: (row.name != "roughvol", row.needed_by != ("roughvol",), row.name.lower()))


def terms(licence: str) -> str:
    """Return what a licence asks of the whole program; of alternatives, the least."""
    whole = _INNER.sub(lambda found: terms(found[1]), licence)
    if whole != licence:
        return terms(whole)
    alternatives = [_strictest(map(_terms_of, re.split(r" AND |, ", one))) for one in licence.split(" OR ")]
    return min(alternatives, key=RANK.index)


def _terms_of(licence: str) -> str:
    if licence in RANK:
        return licence
    if _LIMITED.search(licence) or (_COPYLEFT.search(licence) and " WITH " in licence):
        return LIMITED
    if _COPYLEFT.search(licence):
        return STRONG
    return FREE if _FREE.search(licence) else UNKNOWN


def _strictest(several: Iterable[str]) -> str:
    return max(several, key=RANK.index)


def _row(here: metadata.Distribution, needed_by: list[str]) -> Licence:
    words = here.metadata
    return Licence(words["Name"], words["Version"], _licence(words), tuple(needed_by), dict(sorted(_parts(here))))


def _licence(words: metadata.PackageMetadata) -> str:
    """Return the expression, the short text or the classifiers of the metadata."""
    if expression := words.get_all("License-Expression"):
        return str(expression[0])
    text = "".join(words.get_all("License") or ()).strip()
    classes = [line.rpartition(" :: ")[2] for line in words.get_all("Classifier") or () if _is_licence(line)]
    lines = [line.strip(" #=*") for line in text.splitlines()]
    first = next((line for line in lines if line), "")
    if len(lines) == 1 and first.upper() != "UNKNOWN":
        return first
    return ", ".join(classes) or (first if _FREE.search(first) or _COPYLEFT.search(first) else UNKNOWN)


def _is_licence(classifier: str) -> bool:
    return classifier.startswith("License :: ") and not classifier.endswith((":: OSI Approved", ":: DFSG approved"))


def _parts(here: metadata.Distribution) -> Iterator[tuple[str, str]]:
    """Yield the bundled libraries of a package and the components that its licence files list, with licences."""
    paths = [path.as_posix() for path in here.files or ()]
    listed = [found for path in paths if _is_licence_file(path) for found in _STANZA.findall(_text(here, path))]
    libraries = {path: found[1] for path in paths if (found := _LIBRARY.search(path))}
    for path, name in libraries.items():
        stated = [licence for _, files, licence in listed if _holds(files, path)]
        known = next((licence for licence, starts in PARTS.items() if name.startswith(tuple(starts.split()))), UNKNOWN)
        yield f"lib{name}", " AND ".join(dict.fromkeys(stated)) or known
    for name, files, licence in listed:
        if not any(_holds(files, path) for path in libraries):
            yield name.strip(), licence.strip() or UNKNOWN


def _holds(files: str, path: str) -> bool:
    """Return whether a file is one of the patterns that a licence file lists."""
    return any(fnmatch(path, f"{pattern}*") for pattern in files.split())


def _is_licence_file(path: str) -> bool:
    return ".dist-info/" in path and re.search(r"licen[sc]e|copying|notice", path, re.IGNORECASE) is not None


def _text(here: metadata.Distribution, path: str) -> str:
    return (here.read_text(path.partition(".dist-info/")[2]) or "").replace("\r\n", "\n")


def _direct(name: str, extra: str) -> dict[str, set[str]]:
    """Return the packages that a package requires with an extra, or without for "", each with its own extras."""
    direct: dict[str, set[str]] = {}
    for line in metadata.metadata(name).get_all("Requires-Dist") or ():
        requirement, _, marker = line.partition(";")
        extras = _EXTRA.findall(marker)
        found = _REQUIRED.match(requirement.strip())
        if found and (extra in extras if extra else not extras):
            wanted = filter(None, (word.strip() for word in (found[2] or "").split(",")))
            direct.setdefault(_canonical(found[1]), set()).update(wanted)
    return direct


def _reached(name: str, extra: str) -> list[str]:
    """Return the installed packages that a package needs, also through others; the package is the first."""
    waiting, seen = [(name, extra), (name, "")], {(name, extra), (name, "")}
    while waiting:
        for other, extras in _direct(*waiting.pop()).items():
            new = {(other, one) for one in ("", *extras)} - seen
            if new and _found(other):  # a marker, as another system or Python, leaves a package away
                seen |= new
                waiting += new
    return list(dict.fromkeys([name, *sorted(other for other, _ in seen)]))


def _found(name: str) -> bool:
    return next(iter(metadata.distributions(name=name)), None) is not None


def _canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()
