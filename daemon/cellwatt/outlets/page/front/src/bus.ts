/** Subscriptions to topics. */

export class Bus<Topics extends object> {
  private readonly takers = new Map<keyof Topics, Set<(event: never) => void>>();

  /** Call `take` at each event of a topic, until the function that is returned is called. */
  on<T extends keyof Topics>(topic: T, take: (event: Topics[T]) => void): () => void {
    const takers = this.takers.get(topic) ?? new Set();
    this.takers.set(topic, takers.add(take as (event: never) => void));
    return () => void takers.delete(take as (event: never) => void);
  }

  tell<T extends keyof Topics>(topic: T, event: Topics[T]): void {
    for (const take of [...(this.takers.get(topic) ?? [])]) (take as (event: Topics[T]) => void)(event);
  }
}
