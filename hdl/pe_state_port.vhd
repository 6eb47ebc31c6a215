-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

-- Purpose:  Reads and replaces the states of a network word by word, between a bank of registers and pe_access.
-- Generics: A stored word has up to 64 bits.
-- Timing:   word_o is the word at address_i when settled_o is 1. give_i gives the next new word if free_o is 1. Once a first
--           word was given, access is kept until all have their places, or forget_i.

entity pe_state_port is
  generic (
    STATE_BITS   : positive; -- stored word
    STATE_COUNT  : positive; -- words that are replaced
    STATE_CLOCKS : positive  -- clocks from an address to its word
  );
  port (
    clk_i       : in    std_ulogic;                                 -- clock
    want_i      : in    std_ulogic;                                 -- the host wants access
    new_i       : in    std_ulogic;                                 -- the address is new
    give_i      : in    std_ulogic;                                 -- a new word
    given_i     : in    std_ulogic_vector(63 downto 0);             -- it, sign-extended
    forget_i    : in    std_ulogic;                                 -- the rest of the words will not come
    word_o      : out   std_ulogic_vector(63 downto 0);             -- word at the address, sign-extended
    settled_o   : out   std_ulogic;                                 -- it is that of the address
    granted_o   : out   std_ulogic;                                 -- the host has access
    free_o      : out   std_ulogic;                                 -- a new word can be given
    replacing_o : out   std_ulogic;                                 -- some words were given, not all are in their places
    begins_o    : out   std_ulogic;                                 -- the first one is given
    ce_i        : in    std_ulogic;                                 -- clock enable of the network
    access_o    : out   std_ulogic;                                 -- asks for access
    access_i    : in    std_ulogic;                                 -- there is
    state_i     : in    std_ulogic_vector(STATE_BITS - 1 downto 0); -- word that was read
    state_o     : out   std_ulogic_vector(STATE_BITS - 1 downto 0); -- new word
    valid_o     : out   std_ulogic;                                 -- there is one
    ready_i     : in    std_ulogic                                  -- it is taken
  );
end entity pe_state_port;

architecture rtl of pe_state_port is

  signal given   : natural range 0 to STATE_COUNT             := 0;
  signal waiting : std_ulogic                                 := '0';
  signal word    : std_ulogic_vector(STATE_BITS - 1 downto 0) := (others => '0');
  signal settle  : natural range 0 to STATE_CLOCKS            := STATE_CLOCKS;

  signal replacing : std_ulogic;
  signal free      : std_ulogic;

begin

  replacing <= '1' when given /= 0 else
               '0';
  free      <= (access_i or replacing) and not waiting when given /= STATE_COUNT else
               '0';

  p_give : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      if (waiting = '1' and ready_i = '1' and ce_i = '1') then
        waiting <= '0';
      end if;

      if (give_i = '1' and free = '1') then
        word    <= given_i(STATE_BITS - 1 downto 0);
        waiting <= '1';
        given   <= given + 1;
      end if;

      if (given = STATE_COUNT and waiting = '0' and access_i = '1') then
        given <= 0;
      end if;

      if (forget_i = '1') then
        given   <= 0;
        waiting <= '0';
      end if;
    end if;

  end process p_give;

  p_settle : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      if (new_i = '1' or access_i = '0') then
        settle <= STATE_CLOCKS;
      elsif (settle /= 0 and ce_i = '1') then
        settle <= settle - 1;
      end if;
    end if;

  end process p_settle;

  word_o      <= std_ulogic_vector(resize(signed(state_i), 64));
  settled_o   <= '1' when settle = 0 else
                 '0';
  granted_o   <= access_i and not replacing;
  free_o      <= free;
  replacing_o <= replacing;
  begins_o    <= give_i and free and not replacing;
  access_o    <= want_i or replacing;
  state_o     <= word;
  valid_o     <= waiting;

end architecture rtl;
