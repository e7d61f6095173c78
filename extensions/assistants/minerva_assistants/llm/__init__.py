"""`llm`: answers the requests of agents by a language model, a program, a function or a table.

service      the generator and device
reading      open requests in a view
backends     interface of what completes a prompt: `http`, `local`, `script`
call_runner  calls in a thread of their own
answering    one request: limits, retries, corrections
budgets      prices, budgets and what has been used
cache        former completions on disk
"""

from minerva_assistants.llm.service import Llm

__all__ = ["Llm"]
