"""Table 1: symbols, strings, their text and their vocabulary.

the rules of Table 1, as a parser    grammar/parser.py
strings w, with a class per rule     grammar/scene.py
the alphabets P, T, A and D          grammar/vocabulary.py
events and their conditions c        grammar/events.py, grammar/condition.py
the digest                           grammar/text_and_digest.py
"""
