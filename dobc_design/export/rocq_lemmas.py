"""The lemma on sums of squares in Coq, over the rationals and without axioms: what the check of a witness proves.

Written for the standard library of Coq 8.16.  ``rocq_reals`` proves the same by the same steps for real vectors.
"""

from __future__ import annotations

CHECKER = r"""
(* d (x_pivot + sum of factor x_place)^2: an entry d of D and a column of L. *)
Record term := Term { place : nat; factor : Q }.
Record square := Square { weight : Q; pivot : nat; others : list term }.

Fixpoint find (l : list term) (i : nat) : Q :=
  match l with
  | [] => 0
  | t :: rest => if Nat.eqb i (place t) then factor t else find rest i
  end.

(* Entry i of the column: 1 at the pivot. *)
Definition column (s : square) (i : nat) : Q := if Nat.eqb i (pivot s) then 1 else find (others s) i.

(* Entry (i, j) of L D L'. *)
Fixpoint product (l : list square) (i j : nat) : Q :=
  match l with
  | [] => 0
  | s :: rest =>
      let a := column s i in
      let b := column s j in
      if Qeq_bool a 0 || Qeq_bool b 0 then product rest i j
      else Qred (weight s * (a * b) + product rest i j)
  end.

Definition member (i : nat) (l : list nat) : bool := existsb (Nat.eqb i) l.
Definition all_below (k : nat) (p : nat -> bool) : bool := forallb p (seq 0 k).
Definition same (k : nat) (M N : nat -> nat -> Q) : bool :=
  all_below k (fun i => all_below k (fun j => Qeq_bool (M i j) (N i j))).

(* Every d is positive, and a column has entries at its own pivot and at later pivots only. *)
Fixpoint triangular (k : nat) (l : list square) : bool :=
  match l with
  | [] => true
  | s :: rest =>
      Nat.ltb (pivot s) k && negb (Qle_bool (weight s) 0)
      && all_below k (fun i => Nat.eqb i (pivot s) || member i (map pivot rest) || Qeq_bool (column s i) 0)
      && triangular k rest
  end.

(* D > 0, L unit lower triangular with a pivot in every row, and M = L D L' entry by entry. *)
Definition check (k : nat) (M : nat -> nat -> Q) (l : list square) : bool :=
  triangular k l && all_below k (fun i => member i (map pivot l)) && same k M (product l).

Lemma member_in : forall i l, member i l = true -> In i l.
Proof.
  intros i l H. apply existsb_exists in H. destruct H as [k [Hk E]].
  apply Nat.eqb_eq in E. subst. exact Hk.
Qed.

Lemma all_below_spec : forall k p, all_below k p = true -> forall i, (i < k)%nat -> p i = true.
Proof.
  intros k p H i Hi. unfold all_below in H. rewrite forallb_forall in H.
  apply H. apply in_seq. lia.
Qed.

Lemma same_spec : forall k M N, same k M N = true ->
  forall i j, (i < k)%nat -> (j < k)%nat -> M i j == N i j.
Proof.
  intros k M N H i j Hi Hj. apply Qeq_bool_iff.
  exact (all_below_spec k _ (all_below_spec k _ H i Hi) j Hj).
Qed.

Lemma triangular_step : forall k s rest, triangular k (s :: rest) = true ->
  (pivot s < k)%nat /\ 0 < weight s /\
  (forall i, (i < k)%nat -> i = pivot s \/ In i (map pivot rest) \/ column s i == 0) /\
  triangular k rest = true.
Proof.
  intros k s rest H. cbn [triangular] in H.
  apply andb_prop in H. destruct H as [H T]. apply andb_prop in H. destruct H as [H Z].
  apply andb_prop in H. destruct H as [L D].
  split; [apply Nat.ltb_lt; exact L|]. split.
  { apply Qnot_le_lt. intros N. apply Qle_bool_iff in N. rewrite N in D. discriminate D. }
  split; [|exact T]. intros i Hi. generalize (all_below_spec k _ Z i Hi). intros G. cbn beta in G.
  apply orb_prop in G. destruct G as [G|G].
  - apply orb_prop in G. destruct G as [G|G].
    + left. apply Nat.eqb_eq. exact G.
    + right. left. apply member_in. exact G.
  - right. right. apply Qeq_bool_iff. exact G.
Qed.

Lemma product_step : forall s rest i j,
  product (s :: rest) i j == weight s * (column s i * column s j) + product rest i j.
Proof.
  intros. cbn [product]. destruct (Qeq_bool (column s i) 0) eqn:E; cbn [orb].
  - apply Qeq_bool_iff in E. rewrite E. ring.
  - destruct (Qeq_bool (column s j) 0) eqn:G.
    + apply Qeq_bool_iff in G. rewrite G. ring.
    + rewrite Qred_correct. reflexivity.
Qed.
"""

OVER_Q = r"""
Import Lqa.

Lemma sum_equal : forall k f g, (forall i, (i < k)%nat -> f i == g i) -> sum k f == sum k g.
Proof.
  induction k as [|k IH]; intros f g H; simpl; [reflexivity|].
  rewrite (IH f g) by (intros; apply H; lia). rewrite (H k) by lia. reflexivity.
Qed.

Lemma sum_add : forall k f g, sum k (fun i => f i + g i) == sum k f + sum k g.
Proof. induction k as [|k IH]; intros; simpl; [ring | rewrite IH; ring]. Qed.

Lemma sum_scale : forall k a f, sum k (fun i => a * f i) == a * sum k f.
Proof. induction k as [|k IH]; intros; simpl; [ring | rewrite IH; ring]. Qed.

Lemma sum_zero : forall k f, (forall i, (i < k)%nat -> f i == 0) -> sum k f == 0.
Proof.
  induction k as [|k IH]; intros f H; simpl; [reflexivity|].
  rewrite IH by (intros; apply H; lia). rewrite (H k) by lia. reflexivity.
Qed.

Lemma sum_single : forall k f p, (p < k)%nat ->
  (forall i, (i < k)%nat -> i <> p -> f i == 0) -> sum k f == f p.
Proof.
  induction k as [|k IH]; intros f p Hp H; [lia|]. simpl.
  destruct (Nat.eq_dec p k) as [E|E].
  - subst. rewrite sum_zero by (intros; apply H; lia). ring.
  - rewrite (IH f p) by (try lia; intros; apply H; lia). rewrite (H k) by lia. ring.
Qed.

Lemma form_equal : forall k M N x,
  (forall i j, (i < k)%nat -> (j < k)%nat -> M i j == N i j) -> form k M x == form k N x.
Proof.
  intros k M N x H. unfold form. apply sum_equal. intros i Hi. apply sum_equal. intros j Hj.
  rewrite (H i j Hi Hj). reflexivity.
Qed.

Lemma form_negated : forall k M x, form k (fun i j => - M i j) x == - form k M x.
Proof.
  intros k M x. unfold form.
  rewrite (sum_equal k _ (fun i => (-(1)) * sum k (fun j => x i * M i j * x j))).
  - rewrite sum_scale. ring.
  - intros i _. rewrite <- sum_scale. apply sum_equal. intros. ring.
Qed.

(* The linear form of a square, and the sum of the squares. *)
Definition value (k : nat) (x : nat -> Q) (s : square) : Q := sum k (fun i => column s i * x i).

Definition squares (k : nat) (l : list square) (x : nat -> Q) : Q :=
  fold_right (fun s v => weight s * (value k x s * value k x s) + v) 0 l.

Lemma form_product : forall k l x, form k (product l) x == squares k l x.
Proof.
  intros k l x. induction l as [|s rest IH].
  - unfold form. apply sum_zero. intros. apply sum_zero. intros. cbn [product]. ring.
  - rewrite (form_equal k _ (fun i j => weight s * (column s i * column s j) + product rest i j))
      by (intros; apply product_step).
    unfold squares. cbn [fold_right]. fold (squares k rest x). rewrite <- IH. unfold form.
    rewrite (sum_equal k _ (fun i => weight s * value k x s * (column s i * x i)
      + sum k (fun j => x i * product rest i j * x j))).
    + rewrite sum_add, sum_scale. unfold value. ring.
    + intros i _. rewrite (sum_equal k _ (fun j => (weight s * (column s i * x i)) * (column s j * x j)
        + x i * product rest i j * x j)) by (intros; ring).
      rewrite sum_add, sum_scale. unfold value. ring.
Qed.

Lemma square_positive : forall a, ~ a == 0 -> 0 < a * a.
Proof. intros a N. destruct (Q_dec a 0) as [[L|L]|E]; [nra | nra | contradiction]. Qed.

Lemma squares_nonnegative : forall k l x, triangular k l = true -> 0 <= squares k l x.
Proof.
  intros k l x. induction l as [|s rest IH]; intros H; [apply Qle_refl|].
  destruct (triangular_step k s rest H) as [_ [D [_ T]]]. specialize (IH T).
  unfold squares in *. cbn [fold_right]. nra.
Qed.

(* If the sum of the squares is 0, every x_i is 0: from the last column back to the first. *)
Lemma squares_vanish : forall k l x, triangular k l = true -> squares k l x <= 0 ->
  forall i, In i (map pivot l) -> x i == 0.
Proof.
  intros k l x. induction l as [|s rest IH]; intros H Z i Hi; [destruct Hi|].
  destruct (triangular_step k s rest H) as [Hp [D [Later T]]].
  pose proof (squares_nonnegative k rest x T) as N.
  assert (Zr : squares k rest x <= 0) by (unfold squares in *; cbn [fold_right] in Z; nra).
  assert (Zs : value k x s == 0).
  { assert (S : weight s * (value k x s * value k x s) <= 0)
      by (unfold squares in *; cbn [fold_right] in Z; lra).
    destruct (Qeq_dec (value k x s) 0) as [Y|Y]; [exact Y|].
    pose proof (square_positive _ Y) as Y2. nra. }
  specialize (IH T Zr). cbn [map] in Hi.
  assert (X : x (pivot s) == 0).
  { unfold value in Zs. rewrite (sum_single k _ (pivot s) Hp) in Zs.
    - unfold column in Zs. rewrite Nat.eqb_refl in Zs. rewrite <- Zs. ring.
    - intros j Hj Other. destruct (Later j Hj) as [E|[E|E]]; [contradiction| |].
      + rewrite (IH j E). ring.
      + rewrite E. ring. }
  destruct Hi as [E|E]; [rewrite <- E; exact X | exact (IH i E)].
Qed.

Theorem check_positive : forall k M l, check k M l = true -> positive_definite k M.
Proof.
  intros k M l H x [i [Hi N]]. unfold check in H.
  apply andb_prop in H. destruct H as [H E]. apply andb_prop in H. destruct H as [T Pivots].
  rewrite (form_equal k M (product l) x (same_spec k M (product l) E)).
  rewrite form_product. apply Qnot_le_lt. intros Z. apply N.
  apply (squares_vanish k l x T Z). apply member_in. exact (all_below_spec k _ Pivots i Hi).
Qed.

Theorem check_negative : forall k M l, check k (fun i j => - M i j) l = true -> negative_definite k M.
Proof.
  intros k M l H x N. pose proof (check_positive k _ l H x N) as G. rewrite form_negated in G. lra.
Qed.

(* A matrix computed once and looked up from then on, and a sum that stays in lowest terms. *)
Definition table (k : nat) (M : nat -> nat -> Q) : list (list Q) :=
  map (fun i => map (fun j => Qred (M i j)) (seq 0 k)) (seq 0 k).

Fixpoint short_sum (k : nat) (f : nat -> Q) : Q :=
  match k with
  | O => 0
  | S i => let a := f i in if Qeq_bool a 0 then short_sum i f else Qred (short_sum i f + a)
  end.

(* Whether S is F' V + V F. *)
Definition check_derivative (k : nat) (F V S : nat -> nat -> Q) : bool :=
  let f := matrix (table k F) in
  let v := matrix (table k V) in
  same k S (fun i j => short_sum k (fun h => f h i * v h j + v i h * f h j)).

Lemma nth_table : forall (T : Type) (g : nat -> T) (d : T) k start i,
  (i < k)%nat -> nth i (map g (seq start k)) d = g (start + i)%nat.
Proof.
  intros T g d. induction k as [|k IH]; intros start i H; [lia|]. destruct i as [|i]; simpl.
  - f_equal. lia.
  - rewrite IH by lia. f_equal. lia.
Qed.

Lemma table_spec : forall k M i j, (i < k)%nat -> (j < k)%nat -> matrix (table k M) i j == M i j.
Proof.
  intros k M i j Hi Hj. unfold matrix, table. rewrite nth_table by exact Hi. rewrite nth_table by exact Hj.
  apply Qred_correct.
Qed.

Lemma short_sum_spec : forall k f, short_sum k f == sum k f.
Proof.
  induction k as [|k IH]; intros f; [reflexivity|]. cbn [short_sum sum]. cbv zeta.
  destruct (Qeq_bool (f k) 0) eqn:E.
  - apply Qeq_bool_iff in E. rewrite IH, E. ring.
  - rewrite Qred_correct, IH. reflexivity.
Qed.

Lemma derivative_spec : forall k F V S, check_derivative k F V S = true ->
  forall i j, (i < k)%nat -> (j < k)%nat -> S i j == sum k (fun h => F h i * V h j + V i h * F h j).
Proof.
  intros k F V S H i j Hi Hj. unfold check_derivative in H. cbv zeta in H.
  rewrite (same_spec k _ _ H i j Hi Hj), short_sum_spec. apply sum_equal. intros h Hh.
  rewrite !table_spec by assumption. reflexivity.
Qed.

(* For vectors given as lists. *)
Lemma negative_lists : forall k M, negative_definite k M ->
  forall x : list Q, length x = k -> Exists (fun a => ~ a == 0) x -> form k M (fun i => nth i x 0) < 0.
Proof.
  intros k M H x L N. apply H. apply Exists_exists in N. destruct N as [a [Ha N]].
  destruct (In_nth x a 0 Ha) as [i [Hi E]]. exists i. rewrite E. split; [lia | exact N].
Qed.
"""
