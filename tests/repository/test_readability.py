"""README and docs have short sentences and no private words."""

from pathlib import Path

import pytest
from readability.private_words import page_uses
from readability.sentences import sentences

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
PAGES = [path for path in PAGES if "_generated" not in path.parts]
# words per sentence; sentences of papers of the field have about 25 on average
MEAN, MAX = 16.0, 35
# words in README and docs together: 18,400, half of what they had before they were rewritten, and those of
# pages on later commands (map, check, inverse kinematics, resets, vibrations, control, code, proofs, loops,
MAX_WORDS = 27_850


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_sentences_of_a_page_are_short(page):
    lengths = [len(sentence.split()) for sentence in sentences(page.read_text())]
    if lengths:
        longest = max(sentences(page.read_text()), key=lambda sentence: len(sentence.split()))
        assert max(lengths) <= MAX, longest
        # the mean of few sentences is not significant
        assert len(lengths) < 5 or sum(lengths) / len(lengths) <= MEAN


def test_no_page_has_a_private_word():
    assert [(use.path.name, use.line, use.word) for page in PAGES for use in page_uses(page)] == []


def test_the_documentation_is_within_its_length_limit():
    assert sum(len(page.read_text().split()) for page in PAGES) <= MAX_WORDS


def test_only_sentences_of_prose_are_counted():
    text = "# Title\n\nOne two. Three `a.b c` four?\n\n```sh\nno.\n```\n\n| no. | prose |\n\n- item one.\n"
    assert sentences(text) == ["One two.", "Three x four?", "item one."]
