"""One thread for the linear algebra of small matrices."""

from threadpoolctl import threadpool_limits

# A decorator. Products of 10^4 rows and some ten columns gain nothing from a second thread; on
# shared cores threads that wait for each other took half the processor time of a whole analysis,
# and the last bits of a sum depend on how many share it.
single_threaded = threadpool_limits.wrap(limits=1, user_api="blas")
